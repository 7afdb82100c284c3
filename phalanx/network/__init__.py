"""The way of a broadcast: rules of links, links, and the receiver's inbox."""
