"""An arm that is simulated while one watches: its numbers change, it is pushed, it is recorded."""
