"""The paper's simulations run again, and its figures drawn from them."""
