"""The operator's live view: a page of its own process, which hears a cell as a viewer and commands nothing."""
