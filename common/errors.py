"""The one exception tree of the product.

```
ForefeelError
├── InputError              the input was wrong: one line (where, value, expected), exit 2
│   ├── ConfigurationError  a YAML file or one of its values
│   ├── RecordingError      a file with a recording
│   │   ├── UnclearError    the user can say it in a word
│   │   └── UntimedError    a rate of the rows would do
│   └── EndpointError       a Zenoh endpoint that is taken, malformed or never answers
│       └── NoRouterError   no router answers there yet
├── RunError                the run failed, exit 1
├── CodecError              a byte string that is no message of ours
└── DeviceError             a stage, load cell, gripper or handle; always reaches the safety state
    └── DeviceSetupError    also an InputError: what the configuration names can not be used
```
"""

import shlex
from collections.abc import Mapping
from typing import Any


class ForefeelError(Exception):
    """Root of every error that this product raises on purpose."""


class InputError(ForefeelError):
    """Wrong input of the user; the text is one line that says where, what and what was expected."""

    def answered_by(self, *command: object) -> str:
        """Text of the error in one line. Subclasses that know which options are missing add the command line
        to type, made of `command` and those options.
        """
        return " ".join(str(self).split())


class ConfigurationError(InputError):
    """A configuration file, or one of its values, is wrong."""


class RecordingError(InputError):
    """A recording can not be read, or can not be used as it is."""


class UnclearError(RecordingError):
    """The file leaves open which column is what, or in which unit.

    Attributes:
        doubt: what is not sure.
        columns: what may be meant, by quantity, each as `unit:column`: arguments of `load`, or options.
    """

    def __init__(self, doubt: str, columns: Mapping[Any, Any]) -> None:
        super().__init__(doubt, columns)
        self.doubt, self.columns = doubt, columns

    def __str__(self) -> str:
        arguments = ", ".join(f"{quantity}={text!r}" for quantity, text in self.columns.items())
        return f"{self.doubt}; check columns and units, then add: {arguments}"

    def answered_by(self, *command: object) -> str:
        lacking = [word for quantity, text in self.columns.items() for word in (f"--{quantity}", text)]
        typed = shlex.join(map(str, ("forefeel", *command, *lacking)))
        return f"{self.doubt}; check columns and units, then type: {typed}"


class UntimedError(RecordingError):
    """No column of a table has the time of its rows."""


class EndpointError(InputError):
    """A network endpoint is taken, malformed or unreachable."""


class NoRouterError(EndpointError):
    """A client found no router; one that starts later would do."""


class RunError(ForefeelError):
    """The run was started and failed."""


class CodecError(ForefeelError):
    """A byte string is malformed, truncated, oversized, or not the message that its topic carries."""


class DeviceError(ForefeelError):
    """A device failed or refused; motion is inhibited until an explicit re-arm."""


class DeviceSetupError(DeviceError, InputError):
    """The configuration names no device that can be used: wrong port, wrong device, wrong setting."""


def check_config_alone(*others: object) -> None:
    """Refuses other options beside `--config`; called only where that is given. `others`: their values, which
    are empty, None or False where not given.

    Raises:
        ConfigurationError: one was given.
    """
    if any(others):
        raise ConfigurationError("--config: stands for every option about the network; expected it alone")
