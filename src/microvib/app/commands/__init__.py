"""The commands, by subject; ``microvib.app.cli`` gathers them."""
