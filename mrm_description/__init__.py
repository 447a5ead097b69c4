"""What MRM, my robotic manipulator, is."""

TYPE_CHECKING = False  # typing's constant; typing is slow to import
__version__: str

if not TYPE_CHECKING:  # else any name would be one of the package
    from onebot_description import __getattr__  # noqa: F401 - which knows __version__
