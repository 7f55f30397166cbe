"""What to do next: the recording that decides, and the gains that the corrected rig asks for."""
