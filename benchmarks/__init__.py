"""Commands that print the figures of the README and the docs."""

from train.missing_packages import report_missing_packages

report_missing_packages()
