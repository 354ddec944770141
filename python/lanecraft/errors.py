"""The package's exceptions. Wrong types raise ``TypeError``; Gymnasium's ``ResetNeeded`` and ``ClosedEnvironmentError`` stand for calls
out of order; ``RuntimeError`` for one environment used by two threads at once."""


class LanecraftError(Exception):
    """The base of all exceptions of this package."""


class ConfigError(LanecraftError, ValueError):
    """A configuration, a name or a file that cannot be used; the message names the key, the value, what is allowed and the nearest name."""


class ActionError(LanecraftError, ValueError):
    """An action that does not exist, is out of bounds or, with ``masked_actions="raise"``, is forbidden now. Nothing has moved."""


class SnapshotError(LanecraftError, ValueError):
    """Bytes that are no snapshot, are damaged, or belong to another configuration."""
