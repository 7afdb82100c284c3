"""Running over many hosts: identities, claims of free places, and routers."""
