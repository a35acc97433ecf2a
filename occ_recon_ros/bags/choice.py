"""Which topics of a bag go to which topics of the nodes."""

from collections.abc import Mapping

from occ_recon_ros.errors import UserError
from occ_recon_ros.streams.topics import PLAYED_NAMES, TF, TYPE_NAMES

from .reader import Bag


def choose_topics(bag: Bag, remaps: Mapping[str, str]) -> dict[str, str]:
    """{topic of the bag: topic of the nodes} for all that is to be played.

    /tf and /tf_static are among them where there is no camera_pose.

    Args:
        remaps: {topic of the bag: name it shall have}.

    Raises:
        UserError: a topic is missing, empty or of another type, or a remap fits nothing.
    """
    for source, target in remaps.items():
        if source not in bag.types:
            raise UserError(f"--remap: the bag has no {source}; it has {_listed(bag)}")
        if target not in TYPE_NAMES:
            raise UserError(f"--remap: {target} is none of {', '.join(TYPE_NAMES)}")
    used = (*PLAYED_NAMES, *TF)
    by_target = {topic: topic for topic in bag.types if topic in used and topic not in remaps}
    by_target |= {target: source for source, target in remaps.items()}
    for target, source in by_target.items():
        if bag.types[source] != TYPE_NAMES[target]:
            raise UserError(
                f"{source} of the bag is {bag.types[source]}, {target} must be {TYPE_NAMES[target]}"
            )
    by_target = {target: source for target, source in by_target.items() if bag.counts[source]}
    for plain in ("/image", "/mask"):
        if plain in by_target:
            by_target.pop(f"{plain}/compressed", None)
    if "/camera_pose" in by_target:
        by_target = {target: s for target, s in by_target.items() if target not in TF}
    _refuse_missing(bag, by_target)
    return {source: target for target, source in by_target.items()}


def _refuse_missing(bag: Bag, by_target: Mapping[str, str]) -> None:
    missing = [topic for topic in ("/camera_info", "/camera_pose") if topic not in by_target]
    if set(TF) & by_target.keys():
        missing = [topic for topic in missing if topic != "/camera_pose"]
    if not {"/image", "/image/compressed"} & by_target.keys():
        missing.insert(0, "/image")
    if not missing:
        return
    words = ", ".join(f"{topic} ({TYPE_NAMES[topic]})" for topic in missing)
    # A topic of the right type under another name is probably the one.
    free = {topic: t for topic, t in bag.types.items() if topic not in by_target.values()}
    hints = [
        f"--remap {topic}:={wanted}"
        for wanted in missing
        for topic, msgtype in free.items()
        if msgtype == TYPE_NAMES[wanted]
    ]
    what_to_do = f"try {' '.join(hints[:3])}" if hints else "record it, or name it with --remap"
    raise UserError(f"{bag.path} has no {words}; it has {_listed(bag)}: {what_to_do}")


def _listed(bag: Bag) -> str:
    return ", ".join(f"{topic} ({msgtype})" for topic, msgtype in bag.types.items()) or "nothing"
