"""Commands of `goshawk`, and what all of them share: options, exit statuses, words."""
