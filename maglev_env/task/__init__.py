"""The task that environments and tuners share: episodes, gain box, observation, reward."""
