"""rotavg measured against what its users could pick instead: `./dev bench`. See README.md."""
