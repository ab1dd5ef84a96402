"""A grab that is learned from demonstrations, beside the replay of one of them and beside reference spreading."""
