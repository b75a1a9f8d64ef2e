"""Device links: what the serial and CAN drivers of slave and master share. Protocols here are pure."""
