"""What drives the ticks: real threads and asyncio, or an event heap under a virtual clock. The daemons do not
know which.
"""
