"""Files that users name: those of the catalog by name, others by path, and their text."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from microvib.errors import ScenarioError
from microvib.io.file_access import FileAccess

MAX_FILE_SIZE = 1_000_000  # bytes of the largest scenario file that is read


def catalog_names() -> tuple[str, ...]:
    """List the names of the published scenarios.

    Returns
    -------
    tuple of str
        Names that ``load_scenario``, and whatever takes a scenario, understand.

    Examples
    --------
    >>> import microvib as mv
    >>> "state-1" in mv.catalog_names()
    True
    """
    return tuple(
        name for name in _catalog_files() if name != "new" and not name.startswith(REFERENCE)
    )


REFERENCE = "reference-"  # how names of catalog files begin that describe structures, not scenarios


def reference_names() -> tuple[str, ...]:
    """Names of the structures of the catalog, such as ``reference-array``."""
    return tuple(name for name in _catalog_files() if name.startswith(REFERENCE))


def _catalog_files(folder: str = "") -> list[str]:
    files = (resources.files("microvib.catalog") / folder).iterdir()
    return sorted(f.name[:-5] for f in files if f.name.endswith(".yaml"))


def catalog_text(name: str) -> str:
    """Text of a catalog file, with its comments; ``new`` is the commented file to start from."""
    return (resources.files("microvib.catalog") / f"{name}.yaml").read_text(encoding="utf-8")


def hub_names() -> tuple[str, ...]:
    """Names of the described craft of the catalog, such as ``reference-hub``."""
    return tuple(_catalog_files("hubs"))


def bench_names() -> tuple[str, ...]:
    """Names of the published virtual test benches."""
    return tuple(_catalog_files("benches"))


def test_names() -> tuple[str, ...]:
    """Names of the published tests of the catalog."""
    return tuple(_catalog_files("tests"))


def named_text(
    name: str,
    files: FileAccess,
    *,
    kind: str = "scenario",
    published: tuple[str, ...] | None = None,
    within: str = "",
) -> str:
    """Text of what a user named: a ``published`` name of the catalog, ``within`` a folder of it, or
    one of the ``files``.
    """
    if published is None:
        names = catalog_names()
    else:
        names = published
    if name in names:
        return catalog_text(f"{within}{name}")
    return read_text(files.path(name, names), kind, names)


def read_text(path: Path, kind: str = "scenario", published: tuple[str, ...] | None = None) -> str:
    """Text of a file that a user named, which is to hold a ``kind``; ScenarioError if it is not
    one.
    """
    names = ", ".join(catalog_names() if published is None else published)
    try:
        size = path.stat().st_size
        if path.is_dir():
            raise ScenarioError(
                f"{path}: is a folder; a {kind} file{f' or one of {names}' if names else ''} is"
                " expected"
            )
        if not path.is_file():
            raise ScenarioError(f"{path}: is not a regular file")
        if size > MAX_FILE_SIZE:
            raise ScenarioError(
                f"{path}: has {size / 1e6:.1f} MB; a {kind} file has at most"
                f" {MAX_FILE_SIZE / 1e6:.0f} MB"
            )
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ScenarioError(
            f"{path}: there is no such file"
            + (f" and no catalog {kind} of this name; the catalog has {names}" if names else "")
        ) from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: is not text in UTF-8; a {kind} file is YAML") from None
    except (OSError, ValueError) as error:  # a null byte in the name is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{str(path)[:200]!r}: cannot be read: {reason}") from None
