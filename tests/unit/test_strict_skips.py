"""The gate on skipped tests closes, and only then."""

import pytest

from tests.strict_skips import StrictSkips

pytest_plugins = ["pytester"]


@pytest.mark.parametrize(("allowed", "code"), [("", 1), ("test_it.py::test_skipped  no such device here", 0)])
def test_strict_skips_unlisted_skip_fails_run(pytester: pytest.Pytester, allowed: str, code: int) -> None:
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    pytester.makepyfile(test_it="import pytest\n\ndef test_skipped():\n    pytest.skip('no device')\n")
    result = pytester.inline_run("-p", "no:cacheprovider", plugins=[StrictSkips(f"# why\n{allowed}\n")])
    assert result.ret == code
