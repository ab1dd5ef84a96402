"""What a worker computes with: packages, commit and sources. Results are the same to the bit only where these are."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

from rtstack.experiments.registry import GROUP
from rtstack.trials.provenance import git_commit, package_versions

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("hal", "sim_robot", "rtstack", "deploy")
_GROUPS = (GROUP, "rtstack.controllers", "rtstack.cells", "rtstack.robots")  # whose code shapes a result
_KINDS = (".py", ".toml", ".urdf")
_CHANGED = "+changes"  # git_commit's mark; what was changed is in the digest


@dataclass(frozen=True, slots=True)
class Version:
    """packages: name and version of each that shapes a result; sources: digest of the code and the parameter files of
    rtstack and of the plug-ins.
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
                return f"{name} {version} instead of {wanted.get(name)}"
        if other.commit != self.commit:
            return f"rtstack of commit {other.commit[:12]} instead of {self.commit[:12]}"
        if other.sources != self.sources:
            return f"other sources of rtstack or of a plug-in (digest {other.sources} instead of {self.sources})"
        return None


@lru_cache(maxsize=1)
def present() -> Version:
    """Return what this process has. The first call counts: an update on the disk does not change what is running."""
    digest = hashlib.sha256()
    for folder in [_ROOT / package for package in _PACKAGES] + _plug_ins():
        for path in sorted(path for path in folder.rglob("*") if path.suffix in _KINDS):
            digest.update(str(path.relative_to(folder.parent)).encode())
            digest.update(path.read_bytes())
    plug_ins = {entry.dist.name: entry.dist.version for entry in entry_points(group=GROUP) if entry.dist is not None}
    packages = tuple(sorted((package_versions() | plug_ins).items()))
    return Version(packages, git_commit().removesuffix(_CHANGED), digest.hexdigest()[:16])


def _plug_ins() -> list[Path]:
    """Return the folders of the packages that offer experiments, controllers, cells or robots, but ours."""
    offered = {entry.module.partition(".")[0] for group in _GROUPS for entry in entry_points(group=group)}
    found = (find_spec(name) for name in sorted(offered - set(_PACKAGES)))
    return [Path(folder) for spec in found if spec is not None for folder in spec.submodule_search_locations or ()]
