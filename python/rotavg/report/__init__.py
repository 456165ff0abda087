"""A solution as one self-contained, interactive HTML page (the extra [report])."""

from rotavg.report.page import Run, check_report, html, write_report

__all__ = ["Run", "check_report", "html", "write_report"]
