"""What the plots and the timeline show, and the script that draws them in a browser."""
