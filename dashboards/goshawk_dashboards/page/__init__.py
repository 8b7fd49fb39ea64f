"""What every page has: how it is served and to whom, its colours, and the cards that live view and review share."""
