"""Two hosts on one machine: network namespaces, a cable between them that can be made worse, and the service
on them.
"""
