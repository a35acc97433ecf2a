"""config/rig.yaml, written from the declarations so that it cannot drift from them.

python -m occ_recon_ros.nodes.rig_yaml > config/rig.yaml
"""

import json
import textwrap
from dataclasses import Field, fields

from .parameters import range_text
from .settings import NODE_SETTINGS

_HEAD = """\
# All parameters of all nodes, with their defaults. Written by
#     python -m occ_recon_ros.nodes.rig_yaml > config/rig.yaml
# Use it, or a file with those of the lines that you change, with
#     occ-recon run --params rig.yaml
#     contour_tracker --ros-args --params-file rig.yaml
# "/**/name" means the node of that name in any namespace. The quality of service of each topic
# can be set too, by its full name:
#     qos_overrides:
#       /image:
#         subscription:
#           reliability: reliable
#           depth: 10
"""


def rig_yaml() -> str:
    """The text of config/rig.yaml."""
    blocks = [_HEAD]
    for name, kind in NODE_SETTINGS.items():
        lines = [f"/**/{name}:", "  ros__parameters:"]
        for item in fields(kind):
            lines += [*_comment(item), f"    {item.name}: {json.dumps(item.default)}"]
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _comment(item: Field) -> list[str]:
    meta = item.metadata
    text = str(meta["doc"]).rstrip(".")
    limits = " | ".join(meta.get("choices", ())) or range_text(item)
    text += f" ({limits})" if limits else ""
    text += " [read-only]" if meta.get("read_only") else ""
    return textwrap.wrap(
        text[0].upper() + text[1:], 96, initial_indent="    # ", subsequent_indent="    # "
    )


if __name__ == "__main__":
    print(rig_yaml(), end="")
