"""From a recorded run to report.json and report.html; and what every page is made of: `drawing` for figures,
`template` for pages, `wording` for numbers in words.
"""
