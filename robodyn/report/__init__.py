"""Speed against error."""

from .bench import Result, Row, measure

__all__ = ["Result", "Row", "measure"]
