"""What plots and reports share: what is drawn, and where."""
