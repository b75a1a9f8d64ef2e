"""The certificates of a cell: an authority of the laboratory's own, a certificate for each role."""
