"""Many cases of a scene: solved once each, whatever happens, and put in one table.

`study` is what the user calls, `cases` and `source` say what a case is, `task` solves one where an
executor runs it, `running` sees to it that all are, `store` keeps them. May import all other rooms.
"""
