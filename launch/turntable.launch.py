"""The three nodes, and on request the virtual turntable and RViz, for a full ROS 2 installation.

A node that dies is started again and goes on with the scan; one that was saved is over.

ros2 launch occ_recon_ros turntable.launch.py namespace:=rig image:=/camera/image_raw \
    camera_info:=/camera/camera_info camera_pose:=/turntable/camera_pose
"""

import os
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from occ_recon_ros.streams.topics import TOPICS

PACKAGE = "occ_recon_ros"
INPUTS = {
    row.name: row.doc
    for row in TOPICS
    # The compressed form follows its image; /tf is the same everywhere.
    if row.recorded and not row.name.endswith("/compressed") and not row.name.startswith("/")
}


def generate_launch_description():
    """Three nodes in one namespace; inputs by topic name."""
    rig_yaml = Path(get_package_share_directory(PACKAGE)) / "config" / "rig.yaml"
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="of all nodes"),
        DeclareLaunchArgument("params", default_value=str(rig_yaml), description="parameter file"),
        DeclareLaunchArgument(
            "respawn", default_value="true", description="whether to start a node again that died"
        ),
        DeclareLaunchArgument(
            "resume",
            default_value="true",
            description="whether a node that starts goes on with a scan that was not saved",
        ),
        DeclareLaunchArgument(
            "checkpoint_path",
            default_value="occ_recon_checkpoint",
            description="folder that keeps the scan for that",
        ),
        DeclareLaunchArgument(
            "use_sim_time", default_value="false", description="whether to live by /clock"
        ),
        DeclareLaunchArgument("log_level", default_value="info", description="of all nodes"),
        DeclareLaunchArgument(
            "rviz", default_value="false", description="whether to show the scan in RViz"
        ),
        DeclareLaunchArgument(
            "with_virtual_turntable",
            default_value="false",
            description="whether to start the virtual turntable, which needs no camera",
        ),
        DeclareLaunchArgument(
            "pose",
            default_value="topic",
            choices=["topic", "tf", "board", "turntable"],
            description="board and turntable start the node of that name, which finds the poses; "
            "its file, and pose_source or pose_sync of contour_tracker, are among the parameters",
        ),
        *(
            DeclareLaunchArgument(topic, default_value=topic, description=doc)
            for topic, doc in INPUTS.items()
        ),
    ]
    return LaunchDescription(
        [
            *arguments,
            _node("contour_tracker", remapped=INPUTS, keeps=True),
            _node("reconstructor", keeps=True),
            _node("mesher", remapped=INPUTS, keeps=True),  # with colour it takes the images too
            *(
                _node(
                    f"{pose}_pose",
                    remapped=INPUTS,
                    condition=IfCondition(EqualsSubstitution(LaunchConfiguration("pose"), pose)),
                )
                for pose in ("board", "turntable")
            ),
            _node(
                "virtual_turntable",
                remapped=("image", "camera_info", "camera_pose"),
                condition=IfCondition(LaunchConfiguration("with_virtual_turntable")),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=LaunchConfiguration("namespace"),
                arguments=["-d", str(rig_yaml.with_name("turntable.rviz"))],
                parameters=[{"use_sim_time": _flag("use_sim_time")}],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )


def _flag(name):
    return ParameterValue(LaunchConfiguration(name), value_type=bool)


def _node(name, remapped=(), condition=None, keeps=False):
    parameters = {"use_sim_time": _flag("use_sim_time")}
    if keeps:
        parameters["checkpoint_every"] = 10
        parameters["checkpoint_path"] = LaunchConfiguration("checkpoint_path")
        parameters["resume"] = _flag("resume")
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params"), parameters],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in remapped],
        condition=condition,
        respawn=LaunchConfiguration("respawn"),
        respawn_delay=1.0,
        output="screen",
        emulate_tty=os.isatty(1),
    )
