"""The figures of the papers, made anew, and what is only for them: rigid and swept bodies."""
