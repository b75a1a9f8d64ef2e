"""From a recorded run to its report: report.json, and report.html with figures."""
