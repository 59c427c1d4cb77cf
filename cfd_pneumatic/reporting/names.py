"""Names of the files of results."""

REPORT_FILE = 'report.json'
PARAMETER_FILE = 'parameters.yaml'
PAGE_FILE = 'report.html'
COMPARE_FILE = 'compare.mcap'
