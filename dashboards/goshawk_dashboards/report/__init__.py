"""A flight's report: worked out in `made`, a page (`page`) with charts (`over_time`) and figures (`figures`)."""
