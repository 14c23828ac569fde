"""Speed against error: robodyn beside other libraries on a user's own robots."""

from .bench import KINDS, Row, chain_rows, facts, machine, rows
from .subject import Contest, Settings, Subject
from .timing import Timing

__all__ = ["KINDS", "Contest", "Row", "Settings", "Subject", "Timing", "chain_rows", "facts", "machine", "rows"]
