"""Installation of the package, for colcon (apt ROS) and for pip alike."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = "horizon_sensor_ros"

COMMANDS = {
    "local_vertical_node": "ros.local_vertical_node",
    "attitude_node": "ros.attitude_node",
    "target_pose_node": "ros.target_pose_node",
    "horizon_sensor": "ros.horizon_sensor",
    "horizon_replay": "tools.bags.replay",
    "horizon_self_calibration": "tools.calibration.self_calibration",
    "horizon_report": "tools.report.report",
    "horizon_applicability": "tools.applicability.applicability",
    "horizon_demo": "tools.demo.demo",
    "horizon_bag_from_images": "tools.bags.bag_from_images",
    "horizon_bag_to_csv": "tools.bags.bag_to_csv",
}

# The pages as they are read without Sphinx, which alone reads the list of pages. What start.md
# takes in, and links lead to, lies beside them; what contributing.md does is for the repository.
PAGES = sorted(set(glob("doc/*.md")) - {"doc/index.md", "doc/contributing.md"})
MAINTAINER = "Horizon Sensor ROS maintainers"
EMAIL = "horizon-sensor-ros@users.noreply.github.com"

setup(
    name=PACKAGE,
    version="0.1.0",
    description="Local vertical, roll, pitch and altitude from cameras that see a planet's limb",
    author=MAINTAINER,
    author_email=EMAIL,
    maintainer=MAINTAINER,
    maintainer_email=EMAIL,
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={f"{PACKAGE}.tools.report": ["templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml", "README.md", "CHANGELOG.rst", "LICENSE"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.*"))),
        (f"share/{PACKAGE}/config/integration", sorted(glob("config/integration/*"))),
        (f"share/{PACKAGE}/config/security", sorted(glob("config/security/*"))),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        # Help texts and configuration files refer to them.
        (f"share/{PACKAGE}/doc", PAGES),
        (f"share/{PACKAGE}/doc/pictures", sorted(glob("doc/pictures/*"))),
    ],
    # The libraries come from rosdep (package.xml) or from requirements/run.txt, never from here:
    # apt's OpenCV and rclpy have no pip distribution that such a line could name.
    install_requires=["setuptools"],
    # `colcon test` runs pytest only where it finds it here; without it, unittest, and no test.
    extras_require={"test": ["hypothesis", "pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            f"{name} = {PACKAGE}.{module}:main" for name, module in COMMANDS.items()
        ]
    },
)
