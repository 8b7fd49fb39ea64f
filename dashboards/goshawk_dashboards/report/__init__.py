"""A flight's report: its numbers (summary), its figures (figures), one offline page (page), put together in report."""
