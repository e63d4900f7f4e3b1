"""The native module, or one sentence if this installation lacks it."""

from types import ModuleType


def native() -> ModuleType:
    """`rotortwin._native`.

    Raises ImportError: the package was installed without it, as the client of a server alone.
    """
    try:
        from rotortwin import _native
    except ImportError as error:
        raise ImportError(
            "this install of rotortwin is the client of a server only; flights and analyses in this process need the wheel of"
            " your platform (`cargo xtask dist` makes it)"
        ) from error
    return _native
