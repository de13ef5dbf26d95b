"""Who may do what: identities, roles, the door they come in by, and the record of what they did."""
