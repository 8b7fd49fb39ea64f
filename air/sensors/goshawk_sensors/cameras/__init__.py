"""What delivers images: each as a `source.Source`, with its stamps."""
