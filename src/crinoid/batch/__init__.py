"""Many runs of one scenario as one dataset."""

from crinoid.batch.batch import simulate_batch as simulate_batch
