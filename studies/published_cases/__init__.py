"""Published cases by subject: each is a number from the literature, its source, and the same number by the toolkit."""
