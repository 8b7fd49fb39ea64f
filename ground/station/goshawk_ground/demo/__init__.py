"""`goshawk demo`: three processes, one chase, one verdict; and where its programs and files are."""
