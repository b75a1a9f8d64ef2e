"""One folder per device: settings, protocol, driver, emulator; found by entry points."""
