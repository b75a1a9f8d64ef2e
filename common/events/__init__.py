"""Events, taken once and read in several places.

`axis.AxisEvents` takes what happens on an axis and hands it on: to the network as a message, to the event log
and the flight recorder (`sink.EventSink`), and to the person at the daemon (`console.tell_notices`).
Floods pass an `axis.EventCoalescer` first. `text` words an event, for console and dashboard alike.
"""
