"""Which topics of a bag go to which topics of the nodes."""

from collections.abc import Mapping, Sequence
from itertools import takewhile

from msg_adapters.pose import POSE_TYPES
from occ_recon_ros.errors import UserError
from occ_recon_ros.streams.topics import PLAYED_NAMES, TF, TYPE_NAMES

from .reader import Bag

_COMPRESSED = "/compressed"
_MASKS = ("mask",)
_NO_PICTURES = (*_MASKS, "depth", "disparity")
"""In names of topics of images."""


def choose_topics(bag: Bag, remaps: Mapping[str, str]) -> dict[str, str]:
    """{topic of the bag: topic of the nodes} for all that is to be played.

    Where a topic is missing, the only one of the bag that could be it is taken. /tf and /tf_static
    are among them where there is no camera_pose.

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
    by_target |= {_of_type(bag, source, target): source for source, target in remaps.items()}
    for target, source in by_target.items():
        if bag.types[source] not in _types(target):
            raise UserError(
                f"{source} of the bag is {bag.types[source]}, {target} must be "
                f"{' or '.join(_types(target))}"
            )
    by_target = {target: source for target, source in by_target.items() if bag.counts[source]}
    by_target |= _missing(bag, by_target)
    for plain in ("/image", "/mask"):
        if plain in by_target:
            by_target.pop(f"{plain}{_COMPRESSED}", None)
    if "/camera_pose" in by_target:
        by_target = {target: s for target, s in by_target.items() if target not in TF}
    return {source: target for target, source in by_target.items()}


def _types(target: str) -> tuple[str, ...]:
    """What a topic of the nodes may be in a bag."""
    return POSE_TYPES if target == "/camera_pose" else (TYPE_NAMES[target],)


def _of_type(bag: Bag, source: str, target: str) -> str:
    """The topic of the nodes that a topic of the bag is played on: images may be compressed."""
    other = f"{target}{_COMPRESSED}"
    return other if TYPE_NAMES.get(other) == bag.types[source] else target


def _missing(bag: Bag, by_target: Mapping[str, str]) -> dict[str, str]:
    """{topic of the nodes that is missing: the only topic of the bag that could be it}.

    Raises:
        UserError: there is none, or more than one; says what to try.
    """
    missing = [topic for topic in ("/camera_info", "/camera_pose") if topic not in by_target]
    if set(TF) & by_target.keys():
        missing = [topic for topic in missing if topic != "/camera_pose"]
    if not {"/image", f"/image{_COMPRESSED}"} & by_target.keys():
        missing.insert(0, "/image")
    fitting = {wanted: _fitting(bag, by_target, wanted) for wanted in missing}
    images = fitting.get("/image") or [s for t, s in by_target.items() if t.startswith("/image")]
    if "/image" in missing and not {"/mask", f"/mask{_COMPRESSED}"} & by_target.keys():
        masks = [mask for mask in _of_images(bag, by_target) if _is_any_of(_MASKS, mask)]
        fitting |= {"/mask": masks} if images and masks not in ([], images) else {}
    for wanted in {"/camera_info", "/mask"} & fitting.keys() if images else ():
        fitting[wanted] = _beside(images[0], fitting[wanted], alone=len(images) == 1)
    if all(len(found) == 1 for found in fitting.values()):
        return {_of_type(bag, found[0], wanted): found[0] for wanted, found in fitting.items()}
    words = ", ".join(f"{topic} ({TYPE_NAMES[topic]})" for topic in missing)
    hints = [f"--remap {found[0]}:={wanted}" for wanted, found in fitting.items() if found]
    others = [f"{topic} for {wanted}" for wanted, found in fitting.items() for topic in found[1:]]
    what_to_do = f"try {' '.join(hints)}" if hints else "record it, or name it with --remap"
    if others:
        what_to_do += f" (or {', '.join(others)})"
    raise UserError(f"{bag.path} has no {words}; it has {_listed(bag)}: {what_to_do}")


def _beside(image: str, topics: Sequence[str], alone: bool) -> list[str]:
    """Topics in the order of how much of their names they share with an image; where that is the
    only one, those alone that share most, as other topics of a camera do."""
    found = sorted(topics, key=lambda topic: -_shared(image, topic))
    return [t for t in found if not alone or _shared(image, t) == _shared(image, found[0])]


def _shared(one: str, other: str) -> int:
    """How many parts, from the first on, two topics have in common before the last."""
    pairs = zip(_parts(one)[:-1], _parts(other)[:-1], strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def _parts(topic: str) -> list[str]:
    return topic.removesuffix(_COMPRESSED).strip("/").split("/")


def _is_any_of(words: Sequence[str], topic: str) -> bool:
    return any(word in topic.lower() for word in words)


def _fitting(bag: Bag, by_target: Mapping[str, str], wanted: str) -> list[str]:
    """The topics of the bag that could be one of the nodes', those of its own type first."""
    if wanted == "/image":
        found = _of_images(bag, by_target)
        return [topic for topic in found if not _is_any_of(_NO_PICTURES, topic)] or found
    return _of_types(bag, by_target, _types(wanted))


def _of_images(bag: Bag, by_target: Mapping[str, str]) -> list[str]:
    """Those of images and masks; of one that is sent compressed too that which is not."""
    found = _of_types(bag, by_target, (TYPE_NAMES["/image"], TYPE_NAMES[f"/image{_COMPRESSED}"]))
    plain = {f"{topic}{_COMPRESSED}" for topic in found}
    return [topic for topic in found if topic not in plain]


def _of_types(bag: Bag, by_target: Mapping[str, str], types: Sequence[str]) -> list[str]:
    taken = {source for target, source in by_target.items() if target != "/camera_pose_cov"}
    free = [topic for topic in bag.types if topic not in taken and bag.counts[topic]]
    return [topic for kind in types for topic in free if bag.types[topic] == kind]


def _listed(bag: Bag) -> str:
    return ", ".join(f"{topic} ({msgtype})" for topic, msgtype in bag.types.items()) or "nothing"
