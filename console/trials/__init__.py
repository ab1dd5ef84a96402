"""What a trial ends in: the card with its verdict, three numbers and its impact, and the means of a sweep."""
