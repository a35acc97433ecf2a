from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

package = "occ_recon_ros"

# Lower bounds are what Ubuntu 24.04 ships beside ROS 2 Jazzy where it ships it. What judges the
# code (NumPy by its type stubs) is held to a minor version, for another one judges otherwise.
command = [
    "distributed>=2024.8,<2027",
    "embreex>=4.4,<5",
    "mcap>=1.2.1,<2",
    "pillow>=10,<14",
    "rich>=13.7,<15",
    "rosbags>=0.11.9,<0.12",
    "scikit-image>=0.22,<1",
    "typer>=0.12.4,<1",
    "viser>=1.1,<1.2",  # and its websockets, into whose server the page's guard is put
    "websockets>=14,<17",
    "zstandard>=0.22,<1",  # of messages compressed one by one, as mcap brings it
]
test = [
    "hypothesis>=6.100,<7",
    "manifold3d>=3,<4",  # trimesh unites the parts of a mug with it
    "mypy>=2.4,<2.5",
    "numpy>=2.4,<2.5; python_version >= '3.11'",
    "playwright>=1.45,<2",  # drives a Chromium that is there; downloads none
    "pypdfium2>=4,<6",  # draws the printed board
    "pytest>=7.4,<10",
    "pytest-xdist>=3.7,<4",
    "ruff>=0.17,<0.18",
    "setuptools>=77",
]
bench = [
    "manifold3d>=3,<4",
    "matplotlib>=3.8,<4",
    "pillow>=10,<14",
    "playwright>=1.45,<2",  # a page is opened as the tests do
    "rtree>=1.2,<2",  # trimesh finds the closest point with it
    "pymeshlab>=2022.2,<2026",  # counts triangles that cross each other
    "open3d>=0.19,<0.21; python_version < '3.13'",
    "pytest>=7.4,<10",
]

setup(
    name=package,
    version="0.1.0",
    description="Streaming 3D surface reconstruction from occluding contours, as ROS 2 nodes",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    license_files=["LICENSE"],
    packages=[
        *find_packages(include=[package, f"{package}.*", "msg_adapters"]),
        f"{package}.config",
    ],
    package_dir={f"{package}.config": "config"},
    package_data={f"{package}.config": ["*"], f"{package}.report": ["*.css", "*.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
        (f"share/{package}", ["package.xml"]),
        (f"share/{package}/config", sorted(glob("config/*.*"))),
        (f"share/{package}/launch", sorted(glob("launch/*.launch.py"))),
    ],
    python_requires=">=3.10",
    install_requires=[
        "ros-jazzy-rclpy[fastrtps]>=7.1,<8",
        "ros-jazzy-common-interfaces>=5.3,<6",
        "numba>=0.58,<1",
        "numpy>=1.26,<3",
        "scipy>=1.11,<2",
        "opencv-python-headless>=4.8,<6",
        "pyyaml>=6,<7",
        "trimesh>=5,<6",
    ],
    extras_require={"cli": command, "test": command + test, "bench": command + bench},
    entry_points={
        "console_scripts": [
            "contour_tracker = occ_recon_ros.nodes.contour_tracker:main",
            "reconstructor = occ_recon_ros.nodes.reconstructor:main",
            "board_pose = occ_recon_ros.nodes.board_pose:main",
            "turntable_pose = occ_recon_ros.nodes.turntable_pose:main",
            "mesher = occ_recon_ros.nodes.mesher:main",
            "viewer = occ_recon_ros.nodes.viewer:main",
            "virtual_turntable = occ_recon_ros.nodes.virtual_turntable:main",
            "occ-recon = occ_recon_ros.cli:main",
        ]
    },
)
