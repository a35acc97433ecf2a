"""The commands around printed boards: board, scan, calibrate."""

import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from occ_recon_ros.bags.places import refuse_existing, write_file
from occ_recon_ros.errors import UserError

from .options import Json, Overwrite, Params, Quiet, Settings, Verbose, View, log_level, say, show

Board = Annotated[Path, typer.Option(help="board.yaml, as 'occ-recon board' writes it")]
Out = Annotated[Path, typer.Option(help="YAML file to write")]

calibrate = typer.Typer(help="Calibration from a printed board.", no_args_is_help=True)


def board(
    out: Annotated[Path, typer.Option(help="PDF to write; its .yaml comes beside it")] = Path(
        "board.pdf"
    ),
    kind: Annotated[str, typer.Option(help="charuco, aruco_grid or chessboard")] = "charuco",
    columns: Annotated[int, typer.Option(help="squares, or markers of a grid")] = 7,
    rows: Annotated[int, typer.Option(help="squares, or markers of a grid")] = 10,
    square: Annotated[float, typer.Option(help="side of a square, mm")] = 25.0,
    marker: Annotated[float, typer.Option(help="side of a marker, mm")] = 18.0,
    gap: Annotated[float, typer.Option(help="between the markers of a grid, mm")] = 7.0,
    dictionary: Annotated[str, typer.Option(help="OpenCV's name")] = "DICT_5X5_100",
    first_id: Annotated[int, typer.Option(help="number of the first marker")] = 0,
    paper: Annotated[str, typer.Option(help="a4, a3, a2, a1, a0, letter, tabloid")] = "a4",
    overwrite: Overwrite = False,
) -> None:
    """A board to print in true size, and its board.yaml.

    Print it at 100 %, never "fit to page", and check the bar at its foot: it must measure
    100 mm. Where it does not, scale the lengths in board.yaml by what it measures. Glue the
    sheet onto something flat; the object stands on it, and hides as little as it must.
    """
    from occ_recon_ros.poses import BoardSpec, board_to_yaml, sheet_pdf

    try:
        spec = BoardSpec(
            kind,
            columns,
            rows,
            square_m=square / 1e3,
            marker_m=marker / 1e3,
            gap_m=gap / 1e3,
            dictionary=dictionary,
            first_id=first_id,
        )
        pdf = sheet_pdf(spec, paper)
    except ValueError as error:
        raise UserError(str(error)) from None
    yaml = out.with_suffix(".yaml")
    refuse_existing((out, yaml), overwrite)
    write_file(out, pdf)
    write_file(yaml, board_to_yaml(spec).encode())
    print(f"{out} ({spec.words}) and {yaml}: print at 100 %, check the scale bar, glue it flat")
    if spec.why_no_pose:
        print(spec.why_no_pose)


def scan(
    source: Annotated[
        str | None, typer.Argument(help="folder of photographs, or a video file")
    ] = None,
    camera: Annotated[
        int | None, typer.Option(help="number of a camera of this computer, instead")
    ] = None,
    board: Annotated[
        Path | None, typer.Option(help="board.yaml, as 'occ-recon board' writes it")
    ] = None,
    turn: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="no board: by how much the table turned, either way, before a camera that stands "
            "still, in as many equal steps as there are images; 360: a whole turn, from the last "
            "image on to the first again; of a video about so much",
        ),
    ] = None,
    distance: Annotated[
        float, typer.Option(help="with --turn: of the camera from the table's axis, metres")
    ] = 1.0,
    out: Annotated[Path, typer.Option(help="folder for the results, new or empty")] = Path(
        "occ_recon_scan"
    ),
    camera_info: Annotated[
        Path | None,
        typer.Option(help="calibration as of 'calibrate intrinsics'; else from these images"),
    ] = None,
    masks: Annotated[
        Path | None,
        typer.Option(
            help="folder of masks, named as the photographs: with --board a few are enough, with "
            "--turn only photographs that have one are used"
        ),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="with --board: least angle between two images that are used, deg"),
    ] = None,
    size: Annotated[
        int,
        typer.Option(
            metavar="PX",
            min=0,
            help="photographs larger than this are made so small after their poses were found, px "
            "of the longer side; 0: as they are",
        ),
    ] = 2048,
    params: Params = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
    verbose: Verbose = False,
    view: View = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Photographs of an object on a board, or on a turntable.

    Or a video, or a camera. Poses come from the board, or from the outlines of a turn in equal
    steps; then the unit is arbitrary. The results are those of replay, and the images with
    their poses are kept beside them in scan.mcap.
    """
    from .board_scan import scan_on_board
    from .scan import ScanOptions
    from .turn_scan import scan_turn
    from .watching import watched_alone

    if board is not None and turn is not None:
        raise UserError(
            "--board and --turn are both given: leave out --turn where the board turns with the "
            "object, else --board"
        )
    if board is None and turn is None:
        raise UserError(
            "give --board board.yaml (occ-recon board makes one), or --turn 360 for a turntable "
            "without a board"
        )
    if step is not None and board is None:
        raise UserError("--step goes with --board: --turn uses all images, in equal steps")
    options = ScanOptions(out, params, settings or (), overwrite, log_level(verbose), view=view)
    silent = quiet or as_json
    with watched_alone(view, params, settings or ()):
        if board is not None:
            report = scan_on_board(
                source, camera, board, camera_info, masks, step, size, options, silent
            )
        elif source is None or turn is None:
            raise UserError("--turn needs a folder of photographs or a video file")
        else:
            report = scan_turn(source, turn, distance, camera_info, masks, size, options, silent)
        code = show(report, out, as_json, quiet)
    for line in () if silent else further_steps(report["verdict"], out):
        print(line)
    return code


def further_steps(verdict: Mapping[str, Any], out: Path) -> list[str]:
    """The command that has the options that a verdict advises and ``scan`` does not have."""
    words = " ".join([*verdict["reasons"], *verdict["advice"]])
    options = re.findall(r"--segment joint|--refine|--set [\w.]+=[\w.+-]*\w", words)
    if not any(option.startswith(("--segment", "--refine")) for option in options):
        return []
    bag, again = shlex.quote(str(out / "scan.mcap")), shlex.quote(f"{out}_again")
    return [
        f"  with these: occ-recon replay {bag} {' '.join(dict.fromkeys(options))} --out {again}"
    ]


@calibrate.command("intrinsics")
def intrinsics_(
    source: Annotated[str, typer.Argument(help="recording, video file or folder of photographs")],
    board: Board,
    out: Out = Path("camera.yaml"),
    picture: Annotated[
        Path | None, typer.Option(help="PNG of where the corners were; default beside --out")
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Views of a board -> camera_info YAML, with what is known of it.

    Show the board from 15 sides or more: tilted by 20 to 45 degrees each way, near and far, into
    all corners of the image. The verdict says how well each number is known and which views are
    worst; the picture beside the YAML shows where in the image corners were, so that what is
    empty there can be filled.
    """
    from .calibrating import calibrate_camera
    from .progress import progress_bar

    with progress_bar("looking for the board") as progress:
        lines = calibrate_camera(source, board, out, picture, overwrite, progress)
    say({}, lines)


@calibrate.command("axis")
def axis_(
    source: Annotated[
        str,
        typer.Argument(
            help="recording of images, camera_info and joint_states; or a video file or folder of "
            "photographs, which hold no angles"
        ),
    ],
    board: Board,
    camera_info: Annotated[
        Path | None,
        typer.Option(help="calibration as of 'calibrate intrinsics'; else the recording's"),
    ] = None,
    joint: Annotated[str, typer.Option(help="name in joint_states; else the only one")] = "",
    out: Out = Path("axis.yaml"),
    overwrite: Overwrite = False,
) -> None:
    """A board on a turntable, before a fixed camera -> axis YAML of turntable_pose.

    Lay the board flat on the table, turn it once in 12 steps or more and record images,
    camera_info and joint_states. Poses of the board give the axis, the joint's angles its sense
    and zero; the verdict says how well the axis is known, how far each step is off the circle
    and where the encoder slipped.
    """
    from .calibrating import calibrate_turntable
    from .progress import progress_bar

    with progress_bar("looking for the board") as progress:
        lines = calibrate_turntable(source, board, camera_info, joint, out, overwrite, progress)
    say({}, lines)
