"""`rtstack impact-map`: what velocity follows the impact of a scene file, and how sure that is."""

import json as json_module
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer
from numpy.typing import NDArray

from rtstack.cli.exit_status import FAILED
from rtstack.cli.options import Json

if TYPE_CHECKING:
    from rtstack.impact_map import Impact, ImpactMap

commands = typer.Typer()


@commands.command("impact-map")
def impact_map(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="A scene, such as deploy/impacts/grab.toml.")],
    reflected: Annotated[
        Literal["B_theta", "B", "none"] | None, typer.Option(help="Inertia of the motors; the default is the scene's.")
    ] = None,
    json: Json = False,
) -> None:
    """Say what velocity follows an impact: single step and converged, with impulses, energy and residuals."""
    from rtstack.impact_map import ReflectedInertia, Status, load_scene
    from rtstack.impact_map import impact_map as mapped
    from rtstack.impact_map.scene import SceneError

    found = load_scene(scene)
    if reflected is not None:
        found = replace(found, reflected=ReflectedInertia(reflected))
    try:
        result = mapped(found)
    except SceneError as error:
        raise SceneError(f"{scene}: {error}") from None
    if json:
        typer.echo(json_module.dumps({"reflected": found.reflected.value, **result.as_dict()}))
    else:
        typer.echo(f"reflected inertia {found.reflected.value}; m/s and rad/s, along the world's axes")
        for name in result.problem.names:
            typer.echo(f"  {name:<12} before      {_numbers(result.twist_before(name))}")
        for title, impact in (("single step", result.single_step), ("converged", result.converged)):
            typer.echo("\n".join(_lines(title, result, impact)))
    if {result.single_step.status, result.converged.status} & {Status.INFEASIBLE, Status.UNSOLVED}:
        raise typer.Exit(FAILED)


def _lines(title: str, result: "ImpactMap", impact: "Impact") -> list[str]:
    lines = [f"{title}: {impact.status.value}, {impact.detail}"]
    lines += [f"  {name:<12} after       {_numbers(result.twist(name, impact))}" for name in result.problem.names]
    for k, (contact, rows) in enumerate(zip(result.problem.contacts, result.problem.points, strict=True)):
        normals = " ".join(f"{impulse:8.4f}" for impulse in impact.impulses[rows, 2])
        states = ", ".join(state.value for state in impact.states[rows])
        pressing = f"; to be pressed with {impact.pressing_ns[k]:.3g} Ns" if impact.pressing_ns[k] > 0.0 else ""
        lines.append(f"  {' on '.join(contact.between)}: normal impulses {normals} Ns: {states}{pressing}")
    lines += [
        f"  kinetic energy {impact.kinetic_energy_before_j:.6g} J, then {impact.kinetic_energy_after_j:.6g} J",
        f"  residuals: law {impact.law.worst:.1e}, momentum {impact.momentum_ns:.1e} Ns; impulses "
        f"{'unique' if impact.impulses_unique else 'not unique (redundant contacts)'}",
    ]
    return lines


def _numbers(values: NDArray[np.floating]) -> str:
    return " ".join(f"{value:9.5f}" for value in np.round(values, 5) + 0.0)  # no -0.0
