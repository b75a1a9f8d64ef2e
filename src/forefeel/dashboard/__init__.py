"""The operator's live view: a page of a process of its own, which hears a cell and commands nothing."""
