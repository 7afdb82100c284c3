"""Many hosts for one run: TLS identities of its programs, and routers."""
