"""The report of a run: one HTML file that says who wins, shows every table and replays the episodes.

`drives` and `worlds` are what a run keeps for it, `findings` is what it says, `page` puts the file together from the
assets in the folder `page`.
"""
