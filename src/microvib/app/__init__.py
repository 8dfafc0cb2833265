"""What people touch: the command line, reports and plots."""
