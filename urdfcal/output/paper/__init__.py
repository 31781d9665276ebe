"""The paper's tables and its Fig. 4, published beside repeated: for terminals, as a page, and for LaTeX."""
