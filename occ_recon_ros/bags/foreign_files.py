"""Where the images and masks are that COLMAP and the makers of transforms.json name."""

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from unicodedata import normalize

from occ_recon_ros.errors import UserError

from .photographs import SUFFIXES, find_masks, images_in

_OF_MASKS = re.compile("mask|silhouette", re.IGNORECASE)  # as in images_mask, object_masks
_SUFFIXES = [case for suffix in SUFFIXES for case in (suffix, suffix.upper())]


def image_folders(folder: Path) -> list[Path]:
    """Where the images of a folder may be, those of full size first."""
    return [folder / "images", folder, folder / "input", *sorted(folder.glob("images_*"))]


def other_folders(folder: Path) -> list[Path]:
    """Where else the images of a folder may be: in any of those below it but one of masks."""
    return [
        place
        for place in sorted(folder.iterdir())
        if place.is_dir() and "mask" not in place.name.lower()
    ]


def find_images(folders: Iterable[Path], names: Iterable[str]) -> dict[str, Path]:
    """The files of those names that are there.

    Args:
        folders: the names are relative to one of them, that in which most are found.
        names: with "/" or "\\\\", perhaps of another computer: where no file has a whole name,
            all are taken without their first folder, then without the next.
    """
    posix = {name: name.replace("\\", "/") for name in names}
    parts = {
        name: PurePosixPath(path).parts
        for name, path in posix.items()
        if path.split("/")[-1] not in ("", ".", "..")  # which have no file
    }
    places = [folder for folder in folders if folder.is_dir()]
    for skipped in range(max(map(len, parts.values()), default=0)):
        tails = {name: Path(*all_[min(skipped, len(all_) - 1) :]) for name, all_ in parts.items()}
        found = [
            {name: path for name, tail in tails.items() if (path := _file(place, tail))}
            for place in places
        ]
        if any(found):
            return max(found, key=len)
    return {}


def _file(folder: Path, name: Path) -> Path | None:
    """The file of a name that may lack its suffix or, as of a copy, have another one; and whose
    umlauts may be one letter each, or two as on a Mac."""
    for form in dict.fromkeys((str(name), *(normalize(n, str(name)) for n in ("NFC", "NFD")))):
        path = folder / form
        try:
            if path.is_file():
                return path
            if not path.parent.is_dir():
                continue
            longer = [path.with_name(path.name + suffix) for suffix in _SUFFIXES]
            for other in longer + [path.with_suffix(suffix) for suffix in _SUFFIXES]:
                if other.is_file():
                    return other
        except (OSError, ValueError):  # no name that a file can have
            pass
    return None


def find_masks_beside(images: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """The masks of images: of images/a/1.jpg in masks/a, masks/images/a or masks of a folder,
    of images_4 in masks_4; else in the one folder there that is called after masks.

    Raises:
        UserError: masks that are there belong to no image, to two, or show what is around it.
    """
    shared: dict[Path, list[Path]] = {}
    for place in dict.fromkeys(image.parent for image in images):
        if (masks := _mask_folder(place, folder)) is not None:
            shared.setdefault(masks, []).extend(i for i in images if i.parent == place)
    if images and not shared and (folder / "masks").is_dir():
        shared = {folder / "masks": [*images]}
    found: dict[Path, Path] = {}
    owners: dict[Path, Path] = {}
    for masks, some in shared.items():
        try:
            there = find_masks(masks, [image.name for image in some], option="")
        except UserError:
            if masks.name.startswith("masks"):
                raise
            continue  # it only seemed to hold masks
        for image in some:
            if (mask := there.get(image.name)) is None:
                continue
            if (other := owners.setdefault(mask, image)) != image:
                raise UserError(
                    f"{mask} is the mask of {other} and of {image}: put masks in folders as "
                    "their images are"
                )
            found[image] = mask
    return found


def _mask_folder(images: Path, folder: Path) -> Path | None:
    """Where the masks of a folder of images are."""
    inside = Path(os.path.relpath(images, folder))
    parts = [part for part in inside.parts if part != ".."]
    below = [folder / "masks" / Path(*parts[k:]) for k in range(len(parts) + 1)]
    for masks in (folder / str(inside).replace("images", "masks", 1), *below):
        if masks != images and masks.is_dir() and images_in(masks):
            return masks
    others = {place for where in {folder, images.parent} for place in where.iterdir()} - {images}
    named = [p for p in others if p.is_dir() and _OF_MASKS.search(p.name) and images_in(p)]
    return named[0] if len(named) == 1 else None
