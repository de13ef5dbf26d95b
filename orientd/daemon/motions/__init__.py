"""The motions of a device: queued, fed to the servo, measured, and reported until they arrive."""
