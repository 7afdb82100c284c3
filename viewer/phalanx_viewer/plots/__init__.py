"""Content of the plots and the timeline, and the script that draws them in a browser."""
