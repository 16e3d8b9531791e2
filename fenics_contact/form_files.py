"""What FFCx has compiled, found by its file's name: FFCx reads the whole folder of its cache for each form and space."""

import fcntl
import time
from collections.abc import Sequence
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import IO, Any

from ffcx.codegeneration import jit

_find = jit.get_cached_module
_locks: list[IO[str]] = []  # of what this process compiles; the next call shuts them, or the end of the process


def found(module_name: str, object_names: Sequence[str], cache_dir: str | Path, timeout: int) -> tuple[Any, Any]:
    """Objects and module as FFCx' own function gives them, or (None, None): this process is to compile them.

    Waits while another process that lives compiles them. FFCx waits `timeout` seconds, which a long form takes, and waits
    for a process that was killed as well.
    """
    _shut_locks()
    folder = Path(cache_dir)
    folder.mkdir(exist_ok=True, parents=True)
    ready, library = (folder / (module_name + ending) for ending in (".c.cached", EXTENSION_SUFFIXES[0]))

    def compiled() -> bool:
        return ready.exists() and library.exists()

    while not compiled():
        if (lock := _lock(folder / (module_name + ".lock"))) is None:
            time.sleep(0.1)
        elif compiled():
            lock.close()
        else:
            _locks.append(lock)
            (folder / (module_name + ".c")).unlink(missing_ok=True)  # of a process that was killed
            return _find(module_name, object_names, cache_dir, timeout)
    spec = spec_from_file_location(module_name, library)
    if spec is None or spec.loader is None:
        raise ImportError(f"{library} is no Python module")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return [getattr(module.lib, name) for name in object_names], module


def _lock(path: Path) -> IO[str] | None:
    """The file, open and locked, or None where another process has it. Where files cannot be locked nobody waits."""
    file = path.open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    except OSError:
        pass
    return file


def _shut_locks() -> None:
    while _locks:
        lock = _locks.pop()
        Path(lock.name).unlink(missing_ok=True)
        lock.close()


def by_name() -> None:
    """FFCx finds what it has compiled by its file's name."""
    jit.get_cached_module = found  # FFCx offers no other way in
