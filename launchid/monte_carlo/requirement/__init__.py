"""Prove requirements on a vehicle by flights drawn at random.  The way of a campaign:

    text -> requirement (grammar) --------------------------+
    seeds -> jobs (flight) -> flown (launchid.monte_carlo.campaign) -> table -> watch -> verdict, figures
                                    ^                        |
                                    +------ enough ----------+

`grammar` reads a requirement's text, `flight` flies one seed and measures it, `sequential` says how many failures prove
what, and counts the flights in the order of their seeds (Watch), `folder` is a campaign on disk, flown, continued or
merged, `verdict` its text and its figure.
"""
