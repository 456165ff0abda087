"""A solution as one self-contained, interactive page (the extra [report]); tables for papers."""

from rotavg.report.latex import latex_table
from rotavg.report.page import Run, check_report, html, write_report

__all__ = ["Run", "check_report", "html", "latex_table", "write_report"]
