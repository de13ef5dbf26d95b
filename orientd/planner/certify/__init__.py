"""Hold records against limits as a device differentiates them, and say so in a certificate."""
