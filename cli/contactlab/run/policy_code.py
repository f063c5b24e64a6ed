"""The code of policies, which runs only where the user allows it, and only as it was hashed."""

import sys
from types import ModuleType
from typing import cast

from contactlab.engines import PolicyClass
from contactlab.errors import SceneError, in_one_line
from contactlab.scene.drive.located_drive import LocatedDrive
from contactlab.schema.drive import PolicyDrive


def allowed_policy(drive: LocatedDrive, *, allowed: bool) -> LocatedDrive | None:
    """Return a drive if it is a policy, once its code was loaded to show its mistakes.

    Raises:
        SceneError: it is one, but code is not allowed; or it cannot be loaded.
    """
    if not isinstance(drive.drive, PolicyDrive):
        return None
    if not allowed:
        raise SceneError(
            f"drive: {drive.files[0]} is Python code, which runs only if you allow it; add "
            "--allow-code, or allow_code=True in Python"
        )
    load_policy(drive)
    return LocatedDrive(drive.drive, tuple(file.absolute() for file in drive.files))


def load_policy(located: LocatedDrive) -> PolicyClass:
    """Return the class of a policy, from its file.

    Raises:
        SceneError: the file is not what it was, cannot be run, or has no such class.
    """
    drive, file = located.drive, located.files[0]
    assert isinstance(drive, PolicyDrive)
    located.check()
    module = ModuleType(f"contactlab_policy_{file.stem}")
    module.__file__ = str(file)
    # Classes of the module can be pickled once it is listed.
    sys.modules[module.__name__] = module
    try:
        exec(compile(file.read_bytes(), file, "exec"), module.__dict__)  # noqa: S102 - allowed
    except (Exception, SystemExit) as error:
        raise SceneError(f"policy {file}: {in_one_line(error, __file__)}") from error
    name = drive.policy.rpartition(":")[2]
    found = getattr(module, name, None)
    if not callable(found):
        raise SceneError(f"policy {file}: it has no class {name}{_classes(module)}")
    return cast("PolicyClass", found)


def _classes(module: ModuleType) -> str:
    own = [
        name
        for name, each in vars(module).items()
        if isinstance(each, type) and each.__module__ == module.__name__
    ]
    return f"; write one of {', '.join(own)}" if own else ""
