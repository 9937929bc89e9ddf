"""Numbers that steer the diagnosis, by stage.

A field's docstring gives its unit in brackets (`-`: none), its meaning, and why it is what it is: measured
where, chosen by judgement, or the contract's. Physical limits stand with their cause (`causes/`); how a page
looks, in `report/`.
"""
