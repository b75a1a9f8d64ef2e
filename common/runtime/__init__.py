"""Runtimes that drive the ticks: real threads and asyncio, or an event heap under a virtual clock."""
