"""The report of a run: one HTML file with the result, every table and replays of the episodes.

`drives` and `worlds` are what a run keeps for it, `findings` is what it says, `page` puts the file together from the
assets in the folder `page`.
"""
