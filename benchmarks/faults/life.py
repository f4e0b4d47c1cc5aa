"""A sign of life of a trial that takes many small steps: it may take longer than a single one may."""

signs = 0  # counted up by the trial; its worker tells the campaign
