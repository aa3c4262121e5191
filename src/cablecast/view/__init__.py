"""The page: point at the table, see the planned cast, cast, and look at what happened.

`desk` holds what a person can do and `worker` the work that takes time; neither knows a browser.
`tasks` holds what differs between casts onto the table and strikes in the air.
`scene` and `page` draw them with viser. `film` turns casts into files to share.
"""
