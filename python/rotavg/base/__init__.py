"""What everything uses: errors, checks of arrays, JSON."""
