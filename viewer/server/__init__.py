"""The web server of the live page: aiohttp, one WebSocket for each client.

- `access`: rules of access: Host, Origin, token; headers of all responses
- `page_messages`: messages of the page, validated field by field
- `rate_limit`: limit of messages in a time
- `static_files`: files of the page
- `packing`, `encoding`: messages to the page
- `frames`: what a client lacks, within its budget
- `driving`: the driver of each machine; levers and dead-man
- `backend`: what the server needs of its source
- `client`: one connection
- `hub`: all connections
- `web_server`: the application, in a thread
"""
