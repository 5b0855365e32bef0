"""The paper's network in PyTorch, on our Parquet.

    python train_in_pytorch.py DATASET [EPOCHS]

The trainer's own step is faster on a CPU (docs/results/training-speed.md); this is for those who want to change the network.
"""

import sys

import torch
from graspmill.torch import GraspStream, VoxelNetwork, loss

path, epochs = sys.argv[1], int(sys.argv[2] if len(sys.argv) > 2 else 1)
torch.manual_seed(1)
net = VoxelNetwork()
optimiser = torch.optim.Adam(net.parameters(), lr=3e-4)
train, test = GraspStream(path, "train", batch=48), GraspStream(path, "test-scenes", batch=48, shuffle=False)

for epoch in range(epochs):
    train.set_epoch(epoch)
    for step, batch in enumerate(torch.utils.data.DataLoader(train, batch_size=None)):
        value = loss(*net.at(batch), batch)
        optimiser.zero_grad()
        value.backward()
        optimiser.step()
        if step % 10 == 0:
            print(f"epoch {epoch + 1}, step {step}: {value.item():.3f}", flush=True)
    with torch.no_grad():
        right = [(net.at(batch)[0] > 0.5) == (batch["label"] == 1) for batch in test]
    print(f"epoch {epoch + 1}: accuracy on unseen scenes {torch.cat(right).float().mean():.3f}")

net.save("paper.safetensors")  # graspmill evaluate --model paper.safetensors --data ANOTHER --split all
