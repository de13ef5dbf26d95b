"""Values on the wire: from messages and to messages, errors included."""
