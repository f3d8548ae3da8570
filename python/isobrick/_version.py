"""The version of the package, which is that of isobrick."""

from importlib.metadata import version

__version__: str = version("isobrick")
