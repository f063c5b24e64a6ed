"""What drives runs: controls that hold a posture, noise, exercises, recorded controls."""
