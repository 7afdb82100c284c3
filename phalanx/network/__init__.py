"""What happens to a broadcast on its way: links, and the receiver's inbox."""
