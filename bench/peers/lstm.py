"""Our recurrent network beside PyTorch's: the gradients of one batch for our tests, and the time of an update.

    python lstm.py reference > ../../crates/net/tests/data/lstm.txt
    python lstm.py time

Needs torch. The update is that of `lanecraft bench lstm`: 64 sequences of 10 x 6 inputs, a state of 64, 12 outputs, squared
error, Adam; one thread, like ours, and then as many as PyTorch takes.
"""

import sys
import time

import torch


class Network(torch.nn.Module):
    def __init__(self, inputs, hidden, outputs):
        super().__init__()
        self.lstm = torch.nn.LSTM(inputs, hidden)
        self.readout = torch.nn.Linear(hidden, outputs)

    def forward(self, x):
        states, _ = self.lstm(x)
        return self.readout(states[-1])


def reference():
    """A small network in double precision: what single precision should come near to."""
    torch.manual_seed(1)
    inputs, hidden, outputs, steps, batch = 3, 5, 2, 4, 3
    network = Network(inputs, hidden, outputs).double()
    with torch.no_grad():
        # Every number of the file is one of single precision, so that both start from the same.
        for parameter in network.parameters():
            parameter.copy_(parameter.float().double())
        # We have one bias, PyTorch the sum of two.
        network.lstm.bias_hh_l0.zero_()
    x = torch.randn(steps, batch, inputs).double()
    target = torch.randn(batch, outputs).double()
    y = network(x)
    loss = 0.5 * ((y - target) ** 2).sum()
    loss.backward()

    def ours(of):
        """In our order: weights are inputs x outputs."""
        tensors = [
            of(network.lstm.weight_ih_l0).T,
            of(network.lstm.weight_hh_l0).T,
            of(network.lstm.bias_ih_l0),
            of(network.readout.weight).T,
            of(network.readout.bias),
        ]
        return [value for tensor in tensors for value in tensor.flatten().tolist()]

    rows = {
        "shape": [inputs, hidden, outputs],
        "steps": [steps],
        "parameters": ours(lambda p: p.detach()),
        "inputs": x.flatten().tolist(),
        "targets": target.flatten().tolist(),
        "outputs": y.flatten().tolist(),
        "gradient": ours(lambda p: p.grad),
    }
    for name, values in rows.items():
        print(name, *values)


def update_ms(threads, updates=300):
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    network = Network(6, 64, 12)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    x, target = torch.randn(10, 64, 6), torch.randn(64, 12)
    times = []
    for _ in range(updates):
        begun = time.perf_counter()
        optimizer.zero_grad()
        loss = 0.5 * ((network(x) - target) ** 2).sum()
        loss.backward()
        optimizer.step()
        times.append(1e3 * (time.perf_counter() - begun))
    times.sort()
    return times[len(times) // 2]


if __name__ == "__main__":
    if sys.argv[1:] == ["reference"]:
        reference()
    elif sys.argv[1:] == ["time"]:
        for threads in (1, torch.get_num_threads()):
            print(f"torch {torch.__version__}, {threads} threads: {update_ms(threads):.3f} ms")
    else:
        sys.exit(__doc__)
