"""What a worker computes with: packages, commit and sources. Results are the same to the bit only where these are."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

from rtstack.trials.provenance import git_commit, package_versions

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("hal", "sim_robot", "rtstack", "deploy")
_CODE = " (code "  # behind a plug-in's version
_KINDS = (".py", ".toml", ".urdf")
_CHANGED = "+changes"  # git_commit's mark; what was changed is in the digest


@dataclass(frozen=True, slots=True)
class Version:
    """packages: name and version of each that shapes a result, of plug-ins with a digest of their code; sources: digest
    of the code and the parameter files of rtstack.
    """

    packages: tuple[tuple[str, str], ...]
    commit: str
    sources: str

    @property
    def digest(self) -> str:
        """One word for all of it."""
        return hashlib.sha256(repr((self.packages, self.commit, self.sources)).encode()).hexdigest()[:16]

    def difference(self, other: "Version") -> str | None:
        """Return in words the first thing that `other` has and this has not, None where they are the same."""
        wanted = dict(self.packages)
        for name, version in other.packages:
            if wanted.get(name) != version:
                return f"{name} {version} instead of {wanted.get(name, 'none')}"
        if other.commit != self.commit:
            return f"rtstack of commit {other.commit[:12]} instead of {self.commit[:12]}"
        if other.sources != self.sources:
            return f"other sources of rtstack (digest {other.sources} instead of {self.sources})"
        return None

    @property
    def plug_ins(self) -> "Version":
        """The same of the plug-ins alone."""
        return replace(self, packages=tuple(each for each in self.packages if _CODE in each[1]), commit="", sources="")


@lru_cache(maxsize=1)
def present() -> Version:
    """Return what this process has. The first call counts: an update on the disk does not change what is running."""
    packages = tuple(sorted((package_versions() | _plug_ins()).items()))
    return Version(packages, git_commit().removesuffix(_CHANGED), _digest(_ROOT / package for package in _PACKAGES))


def _digest(places: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for place in places:
        files = [place] if place.is_file() else sorted(path for path in place.rglob("*") if path.suffix in _KINDS)
        for path in files:
            digest.update(str(path.relative_to(place.parent)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _plug_ins() -> dict[str, str]:
    """Return the version of each other package that offers anything to a group of ours, with a digest of its code."""
    offered: dict[tuple[str, str], set[str]] = {}
    for entry in (entry for group in sorted(entry_points().groups) for entry in entry_points(group=group)):
        module = entry.module.partition(".")[0]
        if entry.group.startswith("rtstack.") and module not in _PACKAGES:
            name = (entry.dist.name, entry.dist.version) if entry.dist is not None else (module, "unknown")
            offered.setdefault(name, set()).add(module)
    found: dict[str, str] = {}
    for (name, version), modules in offered.items():
        specs = (find_spec(module) for module in sorted(modules))
        places = [
            Path(place) for spec in specs if spec is not None
            for place in spec.submodule_search_locations or (spec.origin or "",)
        ]  # fmt: skip
        found[name] = f"{version}{_CODE}{_digest(filter(Path.exists, places))})"
    return found
