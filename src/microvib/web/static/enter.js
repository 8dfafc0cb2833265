// The way in: keep the key, which belongs to this host and port alone, and leave no token in the address.

localStorage.setItem("microvib.key", document.querySelector("meta[name=key]").content);
location.replace(`/${location.hash}`);
