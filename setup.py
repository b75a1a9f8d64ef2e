"""The kernels' library in wheels and editable installations; all else stands in pyproject.toml."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

KERNELS = Path("forefeel", "common", "kernels")
spec = spec_from_file_location("kernels_build", "src" / KERNELS / "build.py")
kernels = module_from_spec(spec)
spec.loader.exec_module(kernels)
built_by = ""


class BuildKernels(build_ext):
    def run(self) -> None:
        global built_by  # noqa: PLW0603 - setuptools makes one object a command, without a way between them
        if not self.inplace:
            target = Path(self.build_lib) / KERNELS / kernels.LIBRARY.name
            target.parent.mkdir(parents=True, exist_ok=True)
            built_by = kernels.build(target)
        elif not kernels.is_current(kernels.LIBRARY):
            kernels.build(kernels.LIBRARY)

    def get_ext_filename(self, fullname: str) -> str:
        return str(KERNELS / kernels.LIBRARY.name)


class OneForEveryPython(bdist_wheel):
    def get_tag(self) -> tuple[str, str, str]:
        zig = re.search(r"-target (\w+)-linux-gnu\.2\.17", built_by)
        return "py3", "none", f"manylinux_2_17_{zig[1]}" if zig else super().get_tag()[2]


def compiler_package() -> list[str]:
    """ziglang where there is no compiler: pip installs it for the build and removes it afterwards."""
    try:
        kernels.compiler()
    except kernels.BuildError:
        return ["ziglang>=0.13"]
    return []


setup(
    ext_modules=[Extension("forefeel.common.kernels.libkernels", sources=[])],
    cmdclass={"build_ext": BuildKernels, "bdist_wheel": OneForEveryPython},
    setup_requires=compiler_package(),
)
