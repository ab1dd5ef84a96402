"""A robot that is no Franka: the KUKA LBR iiwa 14 R820, from published numbers, for simulation."""

from pathlib import Path

from hal.robots import read_robot

IIWA14 = read_robot(Path(__file__).with_name("iiwa14.toml"))
