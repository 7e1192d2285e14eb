"""Training scripts and their helper modules."""

from train.missing_packages import report_missing_packages

report_missing_packages()
