"""What a notebook needs: a simulated cell as one object, several trials on worker processes, tables and figures."""
