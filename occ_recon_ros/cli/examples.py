"""What --help shows of each command in use."""

from collections.abc import Mapping, Sequence

import typer

EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "demo": (
        "occ-recon demo --view",
        "occ-recon demo --object torus --noise 0.5 --out torus",
    ),
    "run": (
        "occ-recon run --params rig.yaml --view",
        "occ-recon run --pose board --set board_pose.board=board.yaml",
        "occ-recon run --remap /camera/image_raw:=/image --remap /camera/camera_info:=/camera_info",
    ),
    "import": ("occ-recon import FOLDER scan.mcap",),
    "record": ("occ-recon record scan.mcap --remap /camera/image_raw:=/image",),
    "replay": (
        "occ-recon replay scan.mcap --out scan",
        "occ-recon replay scan.mcap --out smooth --set contour_tracker.smoothing_px=60",
    ),
    "segment": ("occ-recon segment scan.mcap masked.mcap",),
    "refine": ("occ-recon refine scan.mcap refined.mcap",),
    "evaluate": (
        "occ-recon evaluate scan/closed.ply --bag scan.mcap",
        "occ-recon evaluate scan/closed.ply --bag scan.mcap --truth true.ply --within 1.25",
    ),
    "render": ("occ-recon render scan/closed.ply --bag scan.mcap --out pictures --views 0,9,20",),
    "batch": (
        "occ-recon batch vase.mcap cup.mcap --out results",
        "occ-recon batch vase.mcap cup.mcap --out results --workers 4 --option=--segment=joint",
    ),
    "board": (
        "occ-recon board",
        "occ-recon board --out large.pdf --paper a3 --columns 10 --rows 14",
    ),
    "scan": (
        "occ-recon scan PHOTOS --board board.yaml --out cup",
        "occ-recon scan --camera 0 --board board.yaml --out cup",
        "occ-recon scan PHOTOS --turn 360 --out cup",
    ),
    "calibrate intrinsics": (
        "occ-recon calibrate intrinsics PHOTOS --board board.yaml --out camera.yaml",
    ),
    "calibrate axis": ("occ-recon calibrate axis scan.mcap --board board.yaml --out axis.yaml",),
}
"""{command: ways to call it}"""


_FIRST = (
    "occ-recon demo                                         a virtual turntable, to see it work",
    "occ-recon board                                        a sheet to print, and then",
    "occ-recon scan PHOTOS --board board.yaml --out cup     photographs of an object on it",
    "occ-recon COMMAND --help                               more, with examples",
)


def show_examples(app: typer.Typer, before: str = "") -> None:
    """Let the --help of all commands end in their examples."""
    if not before:
        app.info.epilog = _text("To begin:", _FIRST)
    for command in app.registered_commands:
        lines = EXAMPLES.get(f"{before}{command.name}", ())
        title = "Example" if len(lines) == 1 else "Examples"
        if lines:
            command.epilog = _text(f"{title}:", lines)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            show_examples(group.typer_instance, f"{group.name} ")


def _text(title: str, lines: Sequence[str]) -> str:
    return "\b\n" + "\n".join([title, *(f"  {line}" for line in lines)])  # \b: as they are
