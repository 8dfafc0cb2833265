"""What tests share, and benchmarks take from them: scenarios, made signals, ways to run a command."""
