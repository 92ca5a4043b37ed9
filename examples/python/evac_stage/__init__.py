"""Stages of evac in Python: see ../README.md."""

from .bus import Bus, Publisher, Subscriber, now_ns
from .layouts import SERVICES, by_type, structure
from .run import options_of, run_scan_stage

__all__ = ["Bus", "Publisher", "SERVICES", "Subscriber", "by_type", "now_ns", "options_of", "run_scan_stage", "structure"]
