"""The exchange of soil volume between soil and machines: state machines without clock and network.

Messages go into each end through `receive` and come out of `drain_outbox`.

- `session_key`: run, machine and session id, which every message of a machine carries
- `stream_buffers`, `reorder_buffer`: numbered rows, sent again until they have arrived
- `chunks`: rows split into messages; `row_digest`: digests by which headers commit to rows
- `machine_exchange`: the machine's end
    - `join_state`: its states
    - `join_handshake`: what it receives between its join request and its first tick
    - `machine_streams`: the rows it has sent
    - `ticks_in_flight`: the ticks it has sent, and their answers
    - `tick_answer`: the rows of an answer that concern it
- `soil_exchange`: the soil's end
    - `join_admission`: join requests until the end of the tick
    - `welcome`: terrain and backlog for an admitted machine
    - `machine_session`: the state of one joined machine
    - `joined_machines`: the sessions of all joined machines
    - `tick_input`: the rows that all machines sent for one tick
    - `soil_streams`: the rows and headers it has published
    - `ledger_accounts`: the ledger: soil in flight, pending, in particles, absent and outside
        - `machine_account`: the account of one machine
        - `ended_accounts`: the ended accounts of one machine id
- `direct_transport`: carries the messages within one process
- `terrain_follower`: the surface at the end of a tick, for observers that send nothing

Modules are imported by name.
"""

__all__: list[str] = []
