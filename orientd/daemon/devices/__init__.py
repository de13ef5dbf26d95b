"""The servo processes of devices: started, asked, heard, lost, started again."""
