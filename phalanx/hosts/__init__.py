"""Running over many hosts: TLS identities, requests of free places, and routers."""
