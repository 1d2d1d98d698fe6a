"""Requirements proved by flights.  The way of a campaign:

    text -> requirement (grammar) --------------------------+
    seeds -> jobs (flight) -> flown (launchid.monte_carlo.campaign) -> table -> watch -> verdict, figures
                                    ^                        |
                                    +------ enough ----------+

`grammar` says what is asked, `flight` what one flight is and what it is judged by, `sequential` how many failures prove
what, and counts the flights in the order of their seeds (Watch), `folder` is a campaign on disk, flown, continued or
merged, `verdict` its words and its picture.
"""
