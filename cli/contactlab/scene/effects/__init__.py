"""Effects: what each is, which of them a run calls for, and how the others are left out."""
