"""A WebSocket client that is not ours (python3-websocket): connects, patches, acknowledges every picture, closes.
Arguments: address of the stream, number of patches. Prints one line of JSON."""
import json
import struct
import sys

import websocket

url, number = sys.argv[1], int(sys.argv[2])
found = {"version": websocket.__version__, "frames": 0, "last": None}
ws = websocket.create_connection(url, subprotocols=["tomocast.v1"], timeout=30)
found["subprotocol"] = ws.getsubprotocol()
found["hello"] = json.loads(ws.recv())["type"]
for seq in range(1, number + 1):
    ws.send(json.dumps({"type": "patch", "seq": seq, "scene": {"camera": {"fovY": 20 + seq}}}))
ws.ping("are you there")
while not (found["last"] and found["last"]["final"] and found["last"]["seq"] == number):
    opcode, data = ws.recv_data(control_frame=True)
    if opcode == websocket.ABNF.OPCODE_PONG:
        found["pong"] = data.decode()
    if opcode != websocket.ABNF.OPCODE_BINARY:
        continue
    size = struct.unpack("<I", data[:4])[0]
    found["last"] = json.loads(data[4:4 + size])
    found["frames"] += 1
    ws.send(json.dumps({"type": "ack", "frame": found["last"]["frame"]}))
ws.send_close(1000, b"done")
while True:
    opcode, data = ws.recv_data(control_frame=True)
    if opcode == websocket.ABNF.OPCODE_CLOSE:
        found["close"] = struct.unpack("!H", data[:2])[0]
        break
ws.shutdown()
print(json.dumps(found))
