"""Who is who on many hosts: certificates, access rules, claims, and the router."""
