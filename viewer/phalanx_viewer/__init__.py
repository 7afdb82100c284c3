"""The viewer's process: a page that shows a run, live or recorded, and can steer a live one."""
