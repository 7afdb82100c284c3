"""Certify a recorded run, sharing nothing with controller and plant but dynamics and h."""
