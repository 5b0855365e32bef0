"""Built by colcon."""

from setuptools import setup

NAME = "graspmill_ros"

setup(
    name=NAME,
    version="0.3.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/planner.launch.py"]),
        (f"share/{NAME}/config", ["config/params.yaml"]),
    ],
    install_requires=["setuptools", "numpy"],
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": [f"planner = {NAME}.node:main"]},
)
